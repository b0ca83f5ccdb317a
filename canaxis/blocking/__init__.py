"""The client for plain Python: made from `canaxis.asynchronous` by `make client`, but for `waiting`."""
