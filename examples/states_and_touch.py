import haptigraph

config = haptigraph.load_config(settings=["source.uri=phantom:align_then_approach", "run.realtime=false"])
loop = haptigraph.build(config)
state = ""
for step in loop.steps():  # image in, touch out
    if step.conclusion.state != state:
        state = step.conclusion.state
        print(f"{step.stamp_ns / 1e9:5.1f} s  {state}: {step.conclusion.because}")
        print(f"         haptic output: {step.command.pattern.name!r}")
print(f"{loop.report.rate_hz:.0f} images/s")
