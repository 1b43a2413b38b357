"""One browser of the 3D view: its camera, its selection and the card of it."""

from __future__ import annotations

import logging
import time
from typing import Final

import numpy as np
import viser

from dashboard.panels.card import card_html
from dashboard.panels.layout import CARD_ORDER
from dashboard.scene import Drawn, RoadMap, Viewer
from dashboard.scene.viewer import MAX_CANVAS_PX
from dashboard.selection import Selection
from dashboard.view.model import PreviewView

log = logging.getLogger(__name__)

FIT_CAMERA_FOR_S: Final = 10.0
"""Time after a browser connects in which its camera is fitted to its canvas, s."""


class Browser:
    """A connected browser."""

    def __init__(
        self,
        client: viser.ClientHandle,
        road_map: RoadMap,
        selection: Selection | None,
        operator_url: str | None,
    ) -> None:
        self._client = client
        self._operator_url = operator_url
        self._arrived_s = time.monotonic()
        self._canvas: tuple[int, int] | None = None
        self._drawn: Drawn | None = None
        self._picture: PreviewView | None = None
        self._to_visit = selection is not None
        self.viewer = Viewer(client, road_map)
        self.viewer.select(selection)
        self._sent = card_html(None, selection, operator_url)
        self._card = client.gui.add_html(self._sent, order=CARD_ORDER)
        client.camera.on_update(self._on_camera)
        client.scene.on_click()(self._on_click)
        self._on_camera(client.camera)

    def show(self, drawn: Drawn, picture: PreviewView | None) -> None:
        """Follow an update of the map, with the picture of `picture_of`."""
        self._drawn, self._picture = drawn, picture
        self.viewer.show(drawn)
        if self._to_visit:
            self._to_visit = not self.viewer.go_to_selection()
        self._update_card()

    def go(self, where: str) -> None:
        """Move the camera as one of `PLACES` says."""
        if where == PLACES[0]:
            self.viewer.fit()
        elif where == PLACES[1]:
            self.viewer.fit(np.pi / 2)
        else:
            self.viewer.go_to_selection()

    def picture_of(self) -> str | None:
        """The RSU whose picture this browser shows."""
        selected = self.viewer.selection
        return selected.id if selected is not None and selected.kind == "rsu" else None

    def _update_card(self) -> None:
        view = None if self._drawn is None else self._drawn.view
        content = card_html(view, self.viewer.selection, self._operator_url, self._picture)
        if content != self._sent:
            self._sent = content
            self._card.content = content

    def _on_click(self, event: viser.SceneClickEvent) -> None:
        pixel = np.array(event.screen_pos, dtype=np.float64)
        if pixel.shape != (2,) or not np.isfinite(pixel).all():
            return
        camera = self._client.camera
        size = np.array([camera.image_width, camera.image_height])
        self.viewer.select(self.viewer.pick(pixel * size))
        self._picture = None
        self._to_visit = False
        self._update_card()

    def _on_camera(self, camera: viser.CameraHandle) -> None:
        canvas = (camera.image_width, camera.image_height)
        # The canvas shrinks while the browser lays out the panels; afterwards only the user moves
        # the camera. A client may send any number of digits; viser would print the traceback.
        early = time.monotonic() - self._arrived_s <= FIT_CAMERA_FOR_S
        if early and canvas != self._canvas and max(canvas) <= MAX_CANVAS_PX:
            self._canvas = canvas
            self.viewer.fit()
            if self.viewer.selection is not None:
                self.viewer.go_to_selection()
        self.viewer.camera_moved()


PLACES: Final = ("Whole map", "From above", "Selection")
"""Where the buttons of the panel lead the camera."""
