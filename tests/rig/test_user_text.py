"""Whatever a text holds, as a comment it stays a comment: compilers and parsers of each language say so."""

from __future__ import annotations

import ast
import shutil
import subprocess
import tokenize
import tomllib
from io import BytesIO
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from etcfit.rig.user_text import (
    c_comment,
    hash_comment,
    in_c,
    matlab_comment,
    one_line,
    python_comment,
    toml_string,
    xml_comment,
)

# what ends or begins something in one of the languages, and what hides or moves text
PIECES = (*"*/\\?-><!#%{}\"'=: \n\r\t\v\f\0\x1b\x1c\x85\u2028\u2029\u202e\u2066\u200b\ufeff\ufffe\ud800", "\U000e0041",
          "coding", "utf-7", "unicode_escape", "@NAME@", "{{", "]]>", "Ωµ", 60 * "a")  # fmt: skip
HOSTILE = (
    "*/ int hostile; /*",
    "*\\\n/ int hostile; /*",
    "*\\ \n/ int hostile; /*",
    "*??/\n/ int hostile; /*",
    f"{'a ' * 50}*\\ / int hostile; /*",
    "**// int hostile; /*//**/",
    "\\",
    "??/",
    "???/",
    "coding: unicode_escape \\u000aimport hostile",
    "-*- coding: utf-7 -*- +AAo-import hostile",
    "vim: set fileencoding=utf-7 : +AAo-import hostile",
    "x\nimport hostile",
    "x\rimport hostile",
    "x\x85hostile = 1",
    "--> <hostile/> <!--",
    "---> <hostile/> <!---",
    "----> <hostile/>",
    "-",
    "--",
    "{\nhostile = 1;\n",
    "",
)
rng = np.random.default_rng(36)
EVERY = [*HOSTILE, *("".join(rng.choice(PIECES, rng.integers(1, 30))) for _ in range(2000))]


@pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc on this machine")
@pytest.mark.parametrize("language", ["c", "c++"])
def test_no_text_ends_a_comment_of_c(language: str) -> None:
    between = "\n".join(
        f"{c_comment([text, 'note', text])}\nint x{k}; /* {in_c(text)} */" for k, text in enumerate(EVERY)
    )
    how = ["gcc", "-x", language, "-trigraphs", "-Wall", "-Wextra", "-Werror", "-pedantic", "-"]
    done = subprocess.run([*how, "-E", "-P"], input=between.encode(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[:500]
    assert done.stdout.decode().split() == f"{' '.join(f'int x{k};' for k in range(len(EVERY)))}".split()
    assert subprocess.run([*how, "-fsyntax-only"], input=between.encode(), check=False).returncode == 0


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_leaves_a_comment_of_python_or_names_its_encoding(text: str) -> None:
    code = f"{python_comment([text, text])}\nx = 1\n"
    assert tokenize.detect_encoding(BytesIO(code.encode()).readline)[0] == "utf-8"
    assert ast.dump(ast.parse(code.encode())) == ast.dump(ast.parse("x = 1"))


def test_no_text_leaves_a_comment_of_lines() -> None:
    for text in EVERY:
        assert ast.dump(ast.parse(f"{python_comment([text])}\n".encode())) == ast.dump(ast.parse(""))
        for made, mark in ((hash_comment([text]), "#"), (matlab_comment([text]), "%")):
            assert all(line.startswith(f"{mark} ") or line == mark for line in made.splitlines())  # every line end


def test_no_text_ends_a_comment_of_xml_or_makes_it_invalid() -> None:
    for text in EVERY:
        root = Xml.Element("root")
        root.append(Xml.Comment(xml_comment([text])))
        Xml.SubElement(root, "own")
        assert [each.tag for each in Xml.fromstring(Xml.tostring(root))] == ["own"]


def test_every_text_is_one_string_of_toml() -> None:
    for text in EVERY:
        whole = text.replace("\ud800", "")  # half a character is in no file of TOML
        assert tomllib.loads(f"{toml_string(whole)} = {toml_string(whole)}") == {whole: whole}


def test_what_is_printable_is_kept_and_what_nobody_sees_is_its_number() -> None:
    assert one_line("Bänk 3, 25 °C (µ-Ω) 試験台") == "Bänk 3, 25 °C (µ-Ω) 試験台"
    assert one_line(" a\n\tb\x1b[2J \u202ec") == "a b(U+001B)[2J (U+202E)c"
    assert in_c("C:\\rig 3-1/2") == "C:/rig 3-1/2"


def test_a_line_that_begins_further_in_stays_there_over_its_whole_length() -> None:
    lines = hash_comment(["file", f"  -> {'long ' * 40}"]).splitlines()
    assert lines[0] == "# file"
    assert len(lines) > 2
    assert all(line.startswith("#   ") and line[4] != " " and len(line) <= 110 for line in lines[1:])
