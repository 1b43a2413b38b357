"""Another input size for an Ultralytics export that was made for one size only.

Such an export computes its input's size into a few constants: shapes, and the places and strides of
the boxes that the head predicts (Ultralytics' `make_anchors`). They are computed anew; the weights
stay as they are.
"""

from __future__ import annotations

from math import prod
from typing import Final

import numpy as np
import numpy.typing as npt
import openvino as ov
from openvino import opset13

STRIDES: Final = (8, 16, 32)
_DEEPEST: Final = STRIDES[-1]


def resized(model: ov.Model, shape: tuple[int, int]) -> ov.Model | None:
    """A copy of a YOLO11 detector with a fixed input of 1×3×H×W, made for (height, width),
    multiples of 32; None where the model is built in another way: its own size has to do.
    """
    _, _, height, width = model.input(0).shape
    if height % _DEEPEST or width % _DEEPEST:
        return None
    model = model.clone()
    old, new = _anchors((height, width)), _anchors(shape)
    model.get_parameters()[0].set_partial_shape(ov.PartialShape([1, 3, *shape]))
    known = 0
    for operation in model.get_ordered_ops():
        for port in operation.inputs():
            constant = port.get_source_output().get_node()
            if constant.get_type_name() != "Constant":
                continue
            replaced: npt.NDArray[np.int64] | npt.NDArray[np.float32] | None = None
            if operation.get_type_name() == "Reshape" and port.get_index() == 1:
                replaced = _target(np.asarray(constant.data), (height, width), shape)
            elif list(constant.shape)[-1:] == [old[0].shape[-1]]:
                replaced = _anchored(np.asarray(constant.data), old, new)
                if replaced is None:
                    return None
                known += 1
            if replaced is not None:
                port.replace_source_output(opset13.constant(replaced).output(0))
    try:
        model.validate_nodes_and_infer_types()
    except RuntimeError:
        return None
    places = new[0].shape[-1]
    return model if known and model.output(0).partial_shape[2] == places else None


def _anchors(shape: tuple[int, int]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Centres of the cells of all strides, (1, 2, n) in cells, and their strides, (1, 1, n)."""
    centres, strides = [], []
    for stride in STRIDES:
        rows, columns = np.mgrid[0 : shape[0] // stride, 0 : shape[1] // stride]
        centres.append(np.stack([columns.ravel(), rows.ravel()]) + 0.5)
        strides.append(np.full((1, rows.size), stride))
    return (
        np.concatenate(centres, axis=1)[None].astype(np.float32),
        np.concatenate(strides, axis=1)[None].astype(np.float32),
    )


def _anchored(
    data: npt.NDArray[np.float32],
    old: tuple[npt.NDArray[np.float32], ...],
    new: tuple[npt.NDArray[np.float32], ...],
) -> npt.NDArray[np.float32] | None:
    """What replaces a constant with a value for each place; None if it is not an anchor's."""
    for before, after in zip(old, new, strict=True):
        if np.array_equal(data.ravel(), before.ravel()):
            return after.reshape(*data.shape[:-1], -1)
    return None


def _target(
    target: npt.NDArray[np.int64], old: tuple[int, int], new: tuple[int, int]
) -> npt.NDArray[np.int64]:
    """A shape to which a tensor is brought, with the new number of places or of deepest cells."""
    numbers = target.tolist()
    old_places, new_places = (_anchors(size)[0].shape[-1] for size in (old, new))
    old_cells, new_cells = ([side // _DEEPEST for side in size] for size in (old, new))
    if numbers[-1] == old_places:
        numbers[-1] = new_places
    elif len(numbers) == 4 and numbers[-2:] == old_cells:
        numbers[-2:] = new_cells
    elif len(numbers) == 4 and numbers[-1] == prod(old_cells):
        numbers[-1] = prod(new_cells)
    return np.array(numbers, dtype=np.int64)
