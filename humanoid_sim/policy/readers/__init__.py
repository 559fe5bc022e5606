"""Readers of contracts, one per dialect: each returns layers with the fields that its source states."""
