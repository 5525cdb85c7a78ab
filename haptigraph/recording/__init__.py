"""Recordings in MCAP: schema, writer, reader."""
