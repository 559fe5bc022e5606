"""Sito motors (TA40-50, TA40-100): protocol, the host's end, and the watchdog that they need."""
