"""What a GeoPackage says of its layers for people: QGIS styles, and names and meanings of columns."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

#: The date that stands in a file's tables, so that equal content gives equal bytes.
DATE = "2000-01-01T00:00:00.000Z"
_SCHEMA = "http://www.geopackage.org/spec/#extension_schema"
#: Tables of the extension `gpkg_schema` (OGC 12-128r18, annex F.9), and of styles as QGIS makes it.
_TABLES = """
CREATE TABLE IF NOT EXISTS gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL,
  definition TEXT NOT NULL, scope TEXT NOT NULL,
  CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));
CREATE TABLE gpkg_data_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL, name TEXT, title TEXT,
  description TEXT, mime_type TEXT, constraint_name TEXT,
  CONSTRAINT pk_gdc PRIMARY KEY (table_name, column_name), CONSTRAINT gdc_tn UNIQUE (table_name, name));
CREATE TABLE gpkg_data_column_constraints (constraint_name TEXT NOT NULL, constraint_type TEXT NOT NULL,
  value TEXT, min NUMERIC, min_is_inclusive BOOLEAN, max NUMERIC, max_is_inclusive BOOLEAN, description TEXT,
  CONSTRAINT gdcc_ntv UNIQUE (constraint_name, constraint_type, value));
CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256),
  f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30),
  styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30),
  update_time DATETIME);
"""


class Style(NamedTuple):
    """How a layer of polygons is coloured by a column; the first style of a layer is its default."""

    layer: str
    name: str
    column: str
    #: Value, or least and greatest value, → colour as "red,green,blue".
    colours: Mapping[str | tuple[float, float], str]

    @property
    def qml(self) -> str:
        """The style as QGIS writes it."""
        is_graduated = all(isinstance(one, tuple) for one in self.colours)
        kind = "graduatedSymbol" if is_graduated else "categorizedSymbol"
        root = Element("qgis", version="3.34", styleCategories="Symbology")
        renderer = SubElement(root, "renderer-v2", type=kind, attr=self.column, symbollevels="0")
        if is_graduated:
            renderer.set("graduatedMethod", "GraduatedColor")
        entries = SubElement(renderer, "ranges" if is_graduated else "categories")
        symbols = SubElement(renderer, "symbols")
        for number, (value, colour) in enumerate(self.colours.items()):
            shared = {"symbol": str(number), "render": "true"}
            if isinstance(value, tuple):
                low, high = (f"{one:g}" for one in value)
                SubElement(entries, "range", lower=low, upper=high, label=f"{low} to {high}", **shared)
            else:
                SubElement(entries, "category", value=value, label=value, **shared)
            symbol = SubElement(symbols, "symbol", type="fill", name=str(number), alpha="1")
            layer = SubElement(symbol, "layer", {"class": "SimpleFill", "enabled": "1", "pass": "0"})
            options = SubElement(layer, "Option", type="Map")
            for name, told in (
                ("color", f"{colour},255"),
                ("outline_color", "60,60,60,255"),
                ("outline_width", "0.1"),
                ("style", "solid"),
            ):
                SubElement(options, "Option", type="QString", name=name, value=told)
        return f"<!DOCTYPE qgis>\n{ElementTree.tostring(root, encoding='unicode')}"


class Looks(NamedTuple):
    """What people see of a file."""

    styles: Sequence[Style]
    meanings: Mapping[str, str]  #: of columns, by their names


def add_looks(path: Path, looks: Looks, columns: Mapping[str, Sequence[str]]) -> None:
    """Add styles, and names and meanings of columns, to the layers of a GeoPackage that it has."""
    styles = [one for one in looks.styles if one.layer in columns]
    first = {one.layer: one.name for one in reversed(styles)}
    with closing(sqlite3.connect(path)) as file, file:
        file.executescript(_TABLES)
        file.executemany(
            "INSERT INTO gpkg_extensions VALUES (?, NULL, 'gpkg_schema', ?, 'read-write')",
            [(table, _SCHEMA) for table in ("gpkg_data_columns", "gpkg_data_column_constraints")],
        )
        file.executemany(
            "INSERT INTO gpkg_data_columns (table_name, column_name, name, title, description) "
            "VALUES (?1, ?2, ?3, ?3, ?4)",
            [
                (layer, name, name.replace("_", " ").capitalize(), looks.meanings[name])
                for layer, names in columns.items()
                for name in names
                if name in looks.meanings
            ],
        )
        file.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change) "
            "VALUES ('layer_styles', 'attributes', 'layer_styles', '', ?)",
            (DATE,),
        )
        file.executemany(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
            "styleName, styleQML, styleSLD, useAsDefault, description, owner, update_time) "
            "VALUES ('', '', ?, 'geometry', ?, ?, '', ?, ?, '', ?)",
            [
                (one.layer, one.name, one.qml, first[one.layer] == one.name, f"by {one.column}", DATE)
                for one in styles
            ],
        )
