"""The methods of [design]: certified, modal, lipschitz, and theorem1 and corollary1 as the paper prints them."""
