"""From gathered light to whole pictures: fewer traced pixels, filled in; frames accumulated."""
