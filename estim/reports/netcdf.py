"""Groups of arrays as a netCDF-4 file that xarray reads as it would its own; without xarray and pandas, whose import takes longer than to write."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estim.arrays import FloatArray

Variable = tuple[tuple[str, ...], FloatArray, Mapping[str, str]]
"""Dimensions, values, attributes."""


@dataclass(frozen=True, eq=False)
class Group:
    """variables : name -> `Variable`.  coordinates : name -> dimensions and whole numbers.  attributes : texts and whole numbers."""

    variables: Mapping[str, Variable] = field(default_factory=dict)
    coordinates: Mapping[str, tuple[tuple[str, ...], Any]] = field(default_factory=dict)
    attributes: Mapping[str, str | int] = field(default_factory=dict)


def as_netcdf(groups: Mapping[str, Group]) -> bytes:
    """The groups, path -> `Group` ("/" is the file itself), as the bytes of a file.

    By the CF conventions: a coordinate of one dimension bears its name, variables name the others in their attribute `coordinates`.
    """
    import h5netcdf

    buffer = io.BytesIO()
    with h5netcdf.File(buffer, "w") as file:
        for path, group in groups.items():
            _write(file if path == "/" else file.create_group(path), group)
    return buffer.getvalue()


def _write(place: Any, group: Group) -> None:
    for name, said in group.attributes.items():
        place.attrs[name] = said if isinstance(said, str) else np.atleast_1d(said)
    everything = [(dims, np.asarray(values)) for dims, values, *_ in (*group.coordinates.values(), *group.variables.values())]
    place.dimensions = {dim: size for dims, values in everything for dim, size in zip(dims, values.shape, strict=True)}
    for name, (dims, values) in group.coordinates.items():
        place.create_variable(name, dims, data=np.asarray(values, dtype=np.int64))
    for name, (dims, values, about) in group.variables.items():
        variable = place.create_variable(name, dims, data=values, fillvalue=np.nan)
        variable.attrs.update(about)
        along = [other for other, (own, _) in group.coordinates.items() if own != (other,) and set(own) <= set(dims)]
        if along:
            variable.attrs["coordinates"] = " ".join(along)
