"""What differs between machines: processes, threads, compiled code, missing libraries."""
