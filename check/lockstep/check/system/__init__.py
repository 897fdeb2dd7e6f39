"""What a problem says, exactly: its agents, their graph and the closed loop of both in disagreement coordinates."""
