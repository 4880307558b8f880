"""Writers that meet a fault: what stands there is a whole old set of results, a whole new one, or none."""
