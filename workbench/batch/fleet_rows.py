def worst_first(records):
    return list(records)
