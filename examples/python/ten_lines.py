"""Simulate a device, optimize its cords and print their predicted errors."""

import sys

import defsense_fab as df

device = df.Device.load(sys.argv[1])
simulation = df.simulate(device)
layout = df.optimize(simulation)
print(layout.prediction.unseen, "mm RMSE on unseen states")
for noise in (0.001, 0.01):
    print(noise, df.predict(layout, noise=noise).unseen, "mm RMSE with this noise of (R - R0)/R0")
print(df.fabricate(layout))
