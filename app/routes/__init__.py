"""The routes: each validates, hands the work to the master, and shapes the reply."""
