"""What an operator writes, in `canaxis.yaml` and in variables named CANAXIS_..."""
