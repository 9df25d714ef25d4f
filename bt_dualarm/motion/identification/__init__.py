"""Finding out the numbers of a model from measurements.

In: states of an arm, and torques that go with them; factors, values and weights of measurements.
Out: columns that torques are linear in; means and covariances of numbers that are believed in.
Open first: `regressor` (torques of links and loads); others: `beliefs` (least squares).
"""
