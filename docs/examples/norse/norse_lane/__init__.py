"""A controller whose spiking network is written in Norse."""
