"""A campaign: trial by trial in processes of their own, kept as each ends, resumed after any end."""
