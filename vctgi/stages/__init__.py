"""The stages of a frame, each a function of its inputs and its config."""
