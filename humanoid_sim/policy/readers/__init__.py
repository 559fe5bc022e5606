"""Readers of contracts, one per dialect: each gives the fields that its source states, and `merge` joins them."""
