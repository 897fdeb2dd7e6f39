"""`rust/`: a `no_std` crate over the C of the folder, which its build script compiles with the system's compiler."""

from collections.abc import Mapping

from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports.view import folder_view
from lockstep.codegen.manifest import Manifest


def files(manifest: Manifest, _: Mapping[str, str]) -> dict[str, str]:
    """Return the crate: its manifest, build script and source."""
    view = folder_view(manifest) | {"real": f"f{8 * manifest.real_type.bytes}"}
    paths = {"rust/Cargo.toml": "Cargo.toml", "rust/build.rs": "build.rs", "rust/src/lib.rs": "lib.rs"}
    return {path: render(f"exports/{name}.j2", **view) for path, name in paths.items()}
