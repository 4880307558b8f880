"""What becomes of spoilt recordings: right, honest, refused with the right suspicion or another, confidently wrong."""
