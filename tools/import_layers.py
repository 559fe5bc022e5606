"""Layers for import-linter in which `*` is every module that no other layer names: a new module needs no row."""

from __future__ import annotations

from typing import Any

import grimp
from importlinter.contracts.layers import Layer, LayersContract, ModuleTail
from importlinter.domain.contract import ContractCheck

_REST = ModuleTail("*")


class OpenLayers(LayersContract):
    """See `LayersContract`; of one container, all of whose modules it places."""

    type_name = "open_layers"
    layers: Any  # what import-linter's own fields are after they were read
    containers: Any

    def check(self, graph: grimp.ImportGraph, verbose: bool) -> ContractCheck:
        """See `LayersContract`."""
        named = {tail.name for layer in self.layers for tail in layer.module_tails} | {"__main__"}
        children = graph.find_children(self.containers[0].expression)
        rest = {ModuleTail(name) for child in children if (name := child.rpartition(".")[-1]) not in named}
        self.layers = [
            Layer(layer.module_tails - {_REST} | rest, layer.is_independent) if _REST in layer.module_tails else layer
            for layer in self.layers
        ]
        return super().check(graph, verbose)
