"""
Models of buildings at three levels of detail.

Constants were chosen on the virtual roofs of `bench.models.run` unless said otherwise.
"""
