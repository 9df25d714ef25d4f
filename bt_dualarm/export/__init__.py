"""Records in other formats: tables, MCAP, LeRobot data sets, films.

Open first: `tables`.
"""
