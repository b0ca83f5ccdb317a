"""Operations: commands that take time, written down before anything is sent."""
