"""What a report is made of: the steps, and what is left over of each against any variable and period."""
