"""The server extension and the settings with which `make lab` starts JupyterLab."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tools import lab_extension

pytestmark = pytest.mark.slow


ROOT = Path(__file__).resolve().parents[2]

# Starts a server, opens the websocket of a kernel as a browser does, and asks the server's end of
# the socket. In a process of its own, as a server sets signal handlers and changes its classes.
SERVER = """
import asyncio, gc, json, socket, sys
from jupyter_server.serverapp import ServerApp
from jupyter_server.services.kernels.websocket import KernelWebsocketHandler
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

async def ask(app):
    token = {"Authorization": "token secret"}
    base = f"127.0.0.1:{app.port}{app.base_url}api/kernels"
    made = await AsyncHTTPClient().fetch(
        f"http://{base}", method="POST", headers=token, body="{}", request_timeout=60)
    kernel = json.loads(made.body)["id"]
    client = await websocket_connect(
        HTTPRequest(f"ws://{base}/{kernel}/channels?session_id=test", headers=token))
    message = await asyncio.wait_for(client.read_message(), 60)
    handlers = [item for item in gc.get_objects() if isinstance(item, KernelWebsocketHandler)]
    handler, = [item for item in handlers if item.ws_connection is not None]
    option = handler.ws_connection.stream.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    client.close()
    await app._cleanup()
    loaded = "tools.lab_extension" in app.extension_manager.extensions
    print(json.dumps({"loaded": loaded, "nodelay": bool(option), "answered": message is not None}))

async def main():
    app = ServerApp()
    app.initialize(["--no-browser", "--allow-root", "--port=0", "--ip=127.0.0.1",
                    "--IdentityProvider.token=secret", *sys.argv[1:]])
    while not app.http_server._sockets:  # bound by a callback of the loop
        await asyncio.sleep(0.05)
    app.port = next(iter(app.http_server._sockets.values())).getsockname()[1]
    await ask(app)

asyncio.run(main())
"""

SETTINGS = """
import json, sys
from pathlib import Path
from jupyterlab_server.settings_utils import get_settings

lab = Path(sys.prefix, "share", "jupyter", "lab")
found, _ = get_settings(str(lab / "settings"), str(lab / "schemas"), sys.argv[1],
                        "@jupyterlab/apputils-extension:notification")
properties = found["schema"]["properties"]
print(json.dumps({name: properties[name]["default"] for name in ("fetchNews", "checkForUpdates")}))
"""

TOOL_BAR = """
import json, sys
from pathlib import Path
from jupyterlab_server.settings_utils import get_settings

lab = Path(sys.prefix, "share", "jupyter", "lab")
found, _ = get_settings(str(lab / "settings"), str(lab / "schemas"), sys.argv[1],
                        "@jupyterlab/cell-toolbar-extension:plugin")
print(json.dumps(found["schema"]["properties"]["showToolbar"]["default"]))
"""

PAGE = """
import json
from jupyterlab_server.config import get_page_config

page = get_page_config([])
print(json.dumps({name: page.get(name) for name in ("buildCheck", "buildAvailable")}))
"""


def ask(program: str, folder: Path, config: bool, *arguments: str) -> Any:
    """Run `program`, with the course's Jupyter configuration or without, and read its answer."""
    environment = os.environ | {
        "JUPYTER_CONFIG_DIR": str(folder / "config"),
        "JUPYTER_DATA_DIR": str(folder / "data"),
        "JUPYTER_RUNTIME_DIR": str(folder / "runtime"),
        "JUPYTER_CONFIG_PATH": str(ROOT / ".jupyter" if config else folder / "none"),
    }
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.prove
@pytest.mark.parametrize("config", [True, False])
def test_a_kernel_websocket_sends_at_once_where_the_extension_is_on(
    config: bool, tmp_path: Path
) -> None:
    answer = ask(SERVER, tmp_path, config)
    assert answer == {"loaded": config, "nodelay": config, "answered": True}


@pytest.mark.prove
@pytest.mark.parametrize("config", [True, False])
def test_lab_asks_for_no_news(config: bool, tmp_path: Path) -> None:
    news = ask(SETTINGS, tmp_path, config, str(tmp_path))
    if config:
        assert news == {"fetchNews": "false", "checkForUpdates": False}
    else:
        assert news != {"fetchNews": "false", "checkForUpdates": False}


@pytest.mark.prove
@pytest.mark.parametrize("config", [True, False])
def test_no_tool_bar_lies_over_the_text_of_a_cell(config: bool, tmp_path: Path) -> None:
    # JupyterLab's own default is a tool bar inside the active cell.
    assert ask(TOOL_BAR, tmp_path, config, str(tmp_path)) is not config


@pytest.mark.prove
def test_lab_does_not_ask_to_be_built(tmp_path: Path) -> None:
    # A package that Open3D brings along makes Lab open a dialogue over the first notebook.
    assert ask(PAGE, tmp_path, True) == {"buildCheck": False, "buildAvailable": False}
    assert ask(PAGE, tmp_path, False) == {"buildCheck": None, "buildAvailable": None}


def test_loading_twice_wraps_once() -> None:
    calls = []

    class Handler:
        def set_nodelay(self, value: bool) -> None:
            calls.append(value)

        def open(self, kernel_id: str) -> str:
            return f"opened {kernel_id}"

    lab_extension._send_at_once(Handler)
    lab_extension._send_at_once(Handler)
    assert Handler().open("one") == "opened one"
    assert calls == [True]
