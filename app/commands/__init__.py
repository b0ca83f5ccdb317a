"""The subcommands of `canaxis`."""
