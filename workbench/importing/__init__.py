"""Other people's files in: profile files, bags and poses become a recording."""
