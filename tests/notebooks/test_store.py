"""notebooks/store.py: what belongs to a notebook's outputs, and what is left out of them."""

from pathlib import Path

import pytest


def code(text, *outputs):
    return {"cell_type": "code", "source": text, "outputs": list(outputs)}


PRINTED = {"output_type": "stream", "name": "stdout", "text": "3\n"}
PICTURE = {"output_type": "display_data", "data": {"text/plain": "<Figure>", "image/png": "aGk="}}


def test_outputs_belong_to_code_and_not_to_prose(store):
    prose = {"cell_type": "markdown", "source": "# Walk"}
    before = store.fingerprint([prose, code("x = 1"), code("x")])
    assert before == store.fingerprint([code("x = 1"), {"cell_type": "markdown", "source": "y"}, code("x", PRINTED)])
    assert before != store.fingerprint([code("x = 2"), code("x")])
    assert before != store.fingerprint([code("x = 1x")])


def test_lines_and_text_are_the_same_source(store):
    assert store.fingerprint([code("a\nb")]) == store.fingerprint([{**code(""), "source": ["a\n", "b"]}])


def test_kinds_of_what_a_cell_shows(store):
    error = {"output_type": "error", "ename": "ValueError"}
    assert store.kinds(code("", PRINTED, PICTURE)) == ["stdout", "image/png"]
    assert store.kinds(code("", error)) == ["error"]
    assert store.kinds(code("")) == []


def test_what_changes_from_run_to_run_is_left_out(store):
    nbformat = pytest.importorskip("nbformat")
    folder = Path("/tmp/notebook-x1")
    said = f"wrote {folder}/tmp/train_ab12cd34/run.mcap and {store.ROOT}/assets/a.onnx   \n<Robot at 0x7f00ab>\n"
    said += f"│ {store.ROOT}/a.onnx │\n"
    shown = {"application/vnd.jupyter.widget-view+json": {}, "text/plain": f"'{folder}/tmp/x_1/y'"}
    notebook = nbformat.from_dict(
        {
            "metadata": {"widgets": {"state": {}}, "language_info": {"version": "3.11.2"}},
            "cells": [
                code(
                    "run()",
                    {"output_type": "stream", "name": "stdout", "text": said},
                    {"output_type": "execute_result", "data": shown, "metadata": {}, "execution_count": 1},
                )
                | {"metadata": {"execution": {"iopub.execute_input": "2026-01-01T00:00:00Z"}}}
            ],
        }
    )
    store.tidy(notebook, folder, {"kernelspec": {"name": "python3"}})
    stream, result = notebook.cells[0].outputs
    assert (
        stream.text
        == "wrote run.mcap and assets/a.onnx\n<Robot at 0x…>\n│ a.onnx" + " " * (len(str(store.ROOT)) + 2) + "│\n"
    )
    assert result.data == {"text/plain": "'y'"}
    assert notebook.cells[0].metadata == {}
    assert set(notebook.metadata) == {"kernelspec", "humanoid_sim"}
    assert notebook.metadata.humanoid_sim.outputs_of == store.fingerprint([code("run()")])


def test_an_output_of_another_kind_is_told(store):
    nbformat = pytest.importorskip("nbformat")
    stored, same, other = (nbformat.from_dict(code("x", *shown)) for shown in ([PRINTED], [PRINTED], [PICTURE]))
    assert store.compare([stored], [same]) == []
    assert store.compare([stored, stored], [same, other]) == ["cell 1: stored is ['stdout'], now ['image/png']"]
