"""What this machine has of what the project needs. Libraries are tried in processes of their own,
for a broken one may crash or hang."""
