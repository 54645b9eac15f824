"""Benchmarks of fexel: figures beside what was asked for, speed beside error. See README.md."""
