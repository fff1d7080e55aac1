"""The study `audit-power`."""
