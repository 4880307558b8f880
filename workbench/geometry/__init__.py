"""Pure geometry: arrays in, arrays out; no files, no configuration."""
