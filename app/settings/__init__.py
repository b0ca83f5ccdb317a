"""An axis's settings at run time: changed with read-back, kept, compared, rolled back."""
