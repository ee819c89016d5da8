"""Access to a compensator from the host, over any bus that python-can can open."""

from armtrue.device.compensator import Compensator, DeviceRefusedError, Status
from armtrue.device.sdo import CommunicationError, SdoAbortError, SdoClient
from armtrue.device.upload import Step, upload_image

__all__ = [
    "CommunicationError",
    "Compensator",
    "DeviceRefusedError",
    "SdoAbortError",
    "SdoClient",
    "Status",
    "Step",
    "upload_image",
]
