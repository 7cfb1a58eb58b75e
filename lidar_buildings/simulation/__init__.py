"""
Virtual scenes with exact truth, and a virtual airborne scanner.

"""
