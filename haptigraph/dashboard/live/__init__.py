"""The live page: watch a run and steer it."""
