"""How good the search is, problem by problem: `lockstep design` on benchmarks/designs/*.toml, with several seeds each.

Run by hand:  python benchmarks/designs.py [--only NAME]... [--seeds 5] [--jobs N] [--write] [--summary]

Every run is a process of its own, as a user starts it, with one core, in an empty folder. What was measured is kept in
build/designs.json under the problem, the seed, the sources and the kernel of linear algebra, so that an interrupted run
goes on where it stopped, and several runs may measure parts of one table. --write puts the table into docs/designs.md;
--summary holds the figures against what is asked.
"""

import argparse
import fcntl
import hashlib
import json
import math
import os
import platform
import re
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomlkit
from designs_table import ROOT, Case, Row, Run, cases, summary, table_of, verdicts
from page import write

PAGE, RESULTS = ROOT / "docs" / "designs.md", ROOT / "build" / "designs.json"
BEGIN, END = "<!-- table: python benchmarks/designs.py --write -->", "<!-- end of the table -->"
PATIENCE = 20
PACKAGES = ("casadi", "clarabel", "cvxpy", "numpy", "scipy")


def sources() -> str:
    """Return a digest of the package's sources: what was measured of other sources is measured again."""
    digest = hashlib.sha256()
    for file in sorted(
        path for root in ("check", "model", "lmi", "codegen") for path in (ROOT / root).rglob("*.py")
    ):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def kernel() -> str:
    """Return the kernel that NumPy's linear algebra picks here."""
    import numpy  # noqa: F401  loads the library that is asked for
    from threadpoolctl import threadpool_info

    return ", ".join(sorted({str(found.get("architecture", "unknown")) for found in threadpool_info()}))


def key_of(case: Case, seed: int, code: str, core: str) -> str:
    """Return what a result is kept under; comments in the problem file do not matter."""
    problem = hashlib.sha256(json.dumps(case.problem.document(), sort_keys=True).encode()).hexdigest()[:12]
    return f"{case.name} {problem} seed {seed} sources {code} kernel {core}"


def run_of(case: Case, seed: int, limit: float) -> Run:
    """Design with a seed, in a process of its own that is stopped after `limit` seconds."""
    table = tomlkit.parse(case.file.read_text(encoding="utf-8"))
    table.setdefault("design", tomlkit.table())["seed"] = seed
    with tempfile.TemporaryDirectory() as folder:
        file, answer = Path(folder) / f"{case.name}.toml", Path(folder) / "answer.json"
        file.write_text(tomlkit.dumps(table), encoding="utf-8")
        command = [str(Path(sys.executable).with_name("lockstep")), "design", file.name, "-o", "design.json"]
        seconds, late = processor_time([*command, "--jobs", "1", "--json"], answer, limit)
        text = answer.read_text(encoding="utf-8")
    if late:
        return Run(seed, None, False, None, None, round(seconds, 1), stopped_after=limit)
    return read(seed, json.loads(text), seconds)


def processor_time(command: Sequence[str], answer: Path, limit: float) -> tuple[float, bool]:
    """Run a command in the folder of its answer; return its seconds of processor and whether it was stopped.

    limit: s of processor, so that a machine that is shared finds what a free one does; on the clock, `PATIENCE` times that.
    """
    with answer.open("w", encoding="utf-8") as out:
        process = subprocess.Popen(
            command, cwd=answer.parent, stdout=out, stderr=subprocess.DEVNULL, start_new_session=True
        )
    resource.prlimit(process.pid, resource.RLIMIT_CPU, (math.ceil(limit), math.ceil(limit) + 1))
    stopped = threading.Event()

    def stop() -> None:
        stopped.set()
        os.killpg(process.pid, signal.SIGKILL)

    timer = threading.Timer(PATIENCE * limit, stop)
    timer.start()
    _, status, usage = os.wait4(process.pid, 0)
    timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime, stopped.is_set() or process.returncode == -signal.SIGXCPU


def read(seed: int, answer: Mapping[str, Any], seconds: float) -> Run:
    """Return what an answer of `lockstep design --json` says."""
    sampled, error = answer.get("sampled") or {}, answer.get("error") or {}
    certified = bool(answer.get("certified"))
    return Run(
        seed,
        answer["rho"] if certified else None,
        certified and bool(sampled.get("certified")),
        sampled.get("rho") if certified and sampled.get("certified") else None,
        answer.get("floor"),
        round(seconds, 1),
        error.get("message") or sampled.get("not_designed_for_period") or "",
    )


def is_final(kept: Mapping[str, Any] | None, limit: float) -> bool:
    """Say whether a kept result stands: a run that was stopped is tried again with more time."""
    return kept is not None and not (kept["stopped_after"] or math.inf) < limit


def keep(results: Path, key: str, result: dict[str, Any]) -> dict[str, Any]:
    """Add a result to those kept, among which may be new ones of another run, and return them all."""
    results.parent.mkdir(parents=True, exist_ok=True)
    with results.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        kept: dict[str, Any] = json.loads(results.read_text(encoding="utf-8")) if results.exists() else {}
        kept[key] = result
        partial = results.with_suffix(".partial")
        partial.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        partial.replace(results)
    return kept


def measure(found: Sequence[Case], seeds: int, jobs: int, limit: float, results: Path) -> list[Row]:
    """Run what has not been run with these sources, write every result at once, and return the rows."""
    kept = json.loads(results.read_text(encoding="utf-8")) if results.exists() else {}
    code, core = sources(), kernel()
    keys = {(case, seed): key_of(case, seed, code, core) for case in found for seed in range(seeds)}
    missing = [(pair, key) for pair, key in keys.items() if not is_final(kept.get(key), limit)]
    with ThreadPoolExecutor(jobs) as pool:
        started = {pool.submit(run_of, case, seed, limit): key for (case, seed), key in missing}
        for done in as_completed(started):
            kept = keep(results, started[done], asdict(done.result()))
            print(started[done].split(" sources")[0], kept[started[done]], file=sys.stderr, flush=True)
    return [Row(case, tuple(Run(**kept[keys[case, seed]]) for seed in range(seeds))) for case in found]


def machine() -> str:
    """Return in a sentence what the figures were measured on."""
    info = Path("/proc/cpuinfo")
    model = re.search(r"^model name\s*: (.*)$", info.read_text(), re.MULTILINE) if info.exists() else None
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return (
        f"Measured on {os.cpu_count()} cores of {model[1] if model else platform.machine()} (kernel {kernel()}), "
        f"{time.strftime('%B %Y')}, with Python {platform.python_version()}, {packages}; sources {sources()}."
    )


def main() -> int:
    """Measure, and print or write; the exit status is 1 where --summary finds a figure that is not reached."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="this problem; may be repeated"
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="designs at a time, one core each"
    )
    parser.add_argument(
        "--time-limit", type=float, default=900.0, help="s of processor for each design, then it has failed"
    )
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--write", type=Path, nargs="?", const=PAGE, help="put the table into a page")
    parser.add_argument("--summary", action="store_true", help="hold the figures against what is asked")
    asked = parser.parse_args()
    rows = measure(cases(asked.only), asked.seeds, asked.jobs, asked.time_limit, asked.results)
    print(table_of(rows))
    if asked.write:
        text = f"{machine()}\n\n{verdicts(rows)}\n\n{table_of(rows)}"
        write(asked.write, BEGIN, END, text)
    if asked.summary:
        print(verdicts(rows))
    return int(asked.summary and not all(holds for holds, _ in summary(rows)))


if __name__ == "__main__":
    raise SystemExit(main())
