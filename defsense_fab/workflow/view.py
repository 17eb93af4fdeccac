"""Pages in the browser: their server, their messages, live views and guided runs."""

from __future__ import annotations

from ..runtime.view import live_messages as live_messages
from ..runtime.view.client import Client as Client
from ..runtime.view.guided_screen import GuidedScreen as GuidedScreen
from ..runtime.view.live_page import GuidedPage as GuidedPage
from ..runtime.view.live_page import LiveView as LiveView
from ..runtime.view.live_page import open_guided_page as open_guided_page
from ..runtime.view.live_place import LivePlace as LivePlace
from ..runtime.view.messages import Arrays as Arrays
from ..runtime.view.messages import Event as Event
from ..runtime.view.messages import Problem as Problem
from ..runtime.view.messages import Record as Record
from ..runtime.view.messages import Reply as Reply
from ..runtime.view.messages import Request as Request
from ..runtime.view.messages import Result as Result
from ..runtime.view.messages import Upload as Upload
from ..runtime.view.surface_arrays import feature_edges as feature_edges
from ..runtime.view.surface_arrays import surface_arrays as surface_arrays
from ..runtime.view.web_server import HOST as HOST
from ..runtime.view.web_server import MAX_UPLOAD_BYTES as MAX_UPLOAD_BYTES
from ..runtime.view.web_server import Download as Download
from ..runtime.view.web_server import WebServer as WebServer
