"""A device from its folder to the errors that it is predicted to have."""

import sys

import defsense_fab as df

device = df.Device.load(sys.argv[1])
poses = df.simulate(device)
layout = df.optimize(poses)
print(layout.prediction.unseen, "mm RMSE on states that the decoder has not seen")
for noise in (0.001, 0.01):
    print(noise, df.predict(layout, noise=noise).unseen, "mm with this noise of (R - R0)/R0")
print(df.fabricate(layout))
