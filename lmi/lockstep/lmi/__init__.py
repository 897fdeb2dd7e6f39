"""What proposes gains and witnesses, and what reads them back for the checker; nothing in here is trusted."""
