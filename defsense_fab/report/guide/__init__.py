"""The assembly guide: what it says and shows, on pages and on paper."""
