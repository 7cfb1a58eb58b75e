"""What all readers and writers share: complete files, native messages, warnings."""
