"""Who may do what: tokens, roles, tickets, the guard at the door, and the record of commands."""
