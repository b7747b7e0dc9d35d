"""The R-STDP controller (paper section 4): two neurons that learn from the lane distance."""
