def fleet_files(records, title):
    return {}
