"""Files whose columns have types of their own, through pyarrow: Parquet and Feather."""
