"""Readers of robot.yaml, model.yaml, measurements and dataset.yaml. Only `InputError` leaves them."""

from armtrue.io.dataset import Dataset, load_data
from armtrue.io.model import Model, load_model
from armtrue.io.robot import Robot, load_robot

__all__ = ["Dataset", "Model", "Robot", "load_data", "load_model", "load_robot"]
