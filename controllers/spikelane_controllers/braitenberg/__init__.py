"""The Braitenberg controller (paper section 5.3): two neurons with weights set by hand."""
