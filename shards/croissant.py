"""A dataset described in JSON-LD after Croissant 1.1 (https://mlcommons.org/croissant/1.1)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from shards import schema
from shards.licences import licence_url
from shards.manifest import Entry

CONFORMS_TO = "http://mlcommons.org/croissant/1.1"

_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    # Our own block is opaque to JSON-LD: it is read by shards.dataset.
    "rectoverso": {"@id": "urn:rectoverso:dataset", "@type": "@json"},
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""The context that the specification prescribes, and `rectoverso`."""

_BASE_SHARDS = {
    "@type": "cr:FileSet",
    "@id": "base-shards",
    "name": "base-shards",
    "description": "The shards of the dataset linked at base: what those of this one do not hold.",
    "encodingFormat": "application/x-npz",
    "includes": "base/shards/*.npz",
}

_DATA_TYPES = {"b": "sc:Boolean", "u": "cr:UInt8", "f2": "cr:Float16", "f4": "cr:Float32"}
_DATA_TYPES["f8"] = "cr:Float64"


def describe(
    name: str,
    description: str,
    entries: Iterable[Entry],
    members: Mapping[str, schema.ArrayLike],
    lent: Collection[str] = (),
) -> dict[str, Any]:
    """The Croissant document of a dataset.

    Args:
        name: a short identifier.
        description: a sentence or two.
        entries: the finished shards.
        members: name -> shape and type in one of the shards; empty before the first.
        lent: names of the members that lie in the shards of the dataset linked at `base`.
    """
    entries = list(entries)
    fields = [
        _array_field(name, array, "base-shards" if name in lent else "shards")
        for name, array in members.items()
    ]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": name,
        "description": description,
        "version": f"{schema.SCHEMA_VERSION}.0.0",
        "license": sorted({licence_url(entry.licence) for entry in entries}),
        "distribution": [
            *(_file_object(entry) for entry in entries),
            {
                "@type": "cr:FileSet",
                "@id": "shards",
                "name": "shards",
                "description": "One npz for each subject, read by numpy.load without pickle.",
                "encodingFormat": "application/x-npz",
                "includes": "shards/*.npz",
            },
            *([_BASE_SHARDS] if lent else []),
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "subjects",
                "name": "subjects",
                "description": "One record for each subject's shard; views lead every array.",
                "key": {"@id": "subjects/subject"},
                "field": [_subject_field(), *fields],
            }
        ],
    }


def _file_object(entry: Entry) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": entry.file,
        "name": entry.file,
        "contentUrl": entry.file,
        "contentSize": f"{entry.bytes} B",
        "encodingFormat": "application/x-npz",
        "sha256": entry.sha256,
    }


def _subject_field() -> dict[str, Any]:
    return {
        "@type": "cr:Field",
        "@id": "subjects/subject",
        "name": "subjects/subject",
        "description": "The subject's id.",
        "dataType": "sc:Text",
        "source": {
            "fileSet": {"@id": "shards"},
            "extract": {"fileProperty": "filename"},
            "transform": {"regex": r"^(.+)\.npz$"},
        },
    }


def _array_field(name: str, array: schema.ArrayLike, files: str) -> dict[str, Any]:
    kind = array.dtype.kind
    code = kind if kind in "bu" else f"{kind}{array.dtype.itemsize}"
    return {
        "@type": "cr:Field",
        "@id": f"subjects/{name}",
        "name": f"subjects/{name}",
        "description": schema.MEMBERS[name].meaning,
        "dataType": _DATA_TYPES[code],
        "isArray": True,
        # Shards of one dataset may differ in their number of views, never in their images.
        "arrayShape": ",".join(["-1", *(str(n) for n in array.shape[1:])]),
        "source": {"fileSet": {"@id": files}, "extract": {"column": name}},
    }
