"""Operations on session files: validate, repair, merge, split, statistics."""
