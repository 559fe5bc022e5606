"""Readers of contracts, one per dialect: each gives the fields that its source states, and `merge` joins them.

A source that is malformed is an `InputError`, which says where, the field, its value and what is accepted.
"""
