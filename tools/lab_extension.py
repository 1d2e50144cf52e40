"""Jupyter Server extension: a dragged slider gets its picture sooner.

Jupyter Server leaves Nagle's algorithm on for the websocket between browser and kernel, so a small
message can wait for the acknowledgement of the one before it: about 35 ms per round trip. Here the
algorithm is turned off when such a websocket opens. Everything works without it, only slower.

`make lab` turns the extension on through the folder `.jupyter`; by hand:
`jupyter lab --ServerApp.jpserver_extensions="{'tools.lab_extension': True}"`.
"""

import functools
from typing import Any


def _send_at_once(handler_class: Any) -> None:
    """Wrap `open` of a websocket handler class so that its socket doesn't hold back small messages.

    Wrapping the same class again changes nothing. The original `open` is called unchanged, and
    what it returns (a coroutine, for a kernel's websocket) is handed on.
    """
    if getattr(handler_class, "sends_at_once", False):
        return
    original = handler_class.open

    @functools.wraps(original)
    def open_without_delay(self: Any, *args: Any, **kwargs: Any) -> Any:
        self.set_nodelay(True)
        return original(self, *args, **kwargs)

    handler_class.open = open_without_delay
    handler_class.sends_at_once = True


def _jupyter_server_extension_points() -> list[dict[str, str]]:
    return [{"module": "tools.lab_extension"}]


def _load_jupyter_server_extension(serverapp: Any) -> None:
    from jupyter_server.services.kernels.websocket import KernelWebsocketHandler

    _send_at_once(KernelWebsocketHandler)
    serverapp.log.info("course: kernel websockets send at once (TCP_NODELAY)")
