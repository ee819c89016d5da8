"""The data of a report: the steps, and the residuals of each against state variables and periods."""
