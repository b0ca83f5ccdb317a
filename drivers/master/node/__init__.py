"""One node: how it is found, taken in and watched over; its inputs, outputs and memory."""
