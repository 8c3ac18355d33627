"""`tendril log export`: LCM logs as MCAP, CSV and Parquet."""
