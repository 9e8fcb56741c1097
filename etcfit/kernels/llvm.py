"""A loop as text in LLVM's intermediate representation.

    void loop(i64 rows, i64 stride, double *record_0, ..., double *fixed, double *carried, double *sums, double *stored)

Numbers are doubles; a vector holds `width` of them. A row of a record has one column for each input, each as wide as
`stride`, of which a loop over points reads the first. Carried numbers, sums and stored ones are always vectors.

Denormal numbers count as zero on x86: what decays towards zero would take a hundred times as long. Sums of products may
be contracted, quotients of one denominator share its reciprocal.
"""

from __future__ import annotations

import math
import struct
import sys
from collections import Counter
from collections.abc import Iterator, Sequence

from .loop import Across, Loop

NAME = "loop"
LIBRARY = (
    "expm1", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh",
    "atanh", "cbrt", "erf", "erfc", "pow", "atan2",
)  # fmt: skip
"""Functions of C's library that are called."""

_FLAGS = "contract nsz arcp"
_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_COMPARED = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
_INTRINSIC = {"abs": "fabs", "sqrt": "sqrt", "floor": "floor", "ceil": "ceil", "round": "rint"}
_KEPT = 16  # numbers carried in registers; more go through memory, which LLVM handles better
_LEAST = sys.float_info.min  # what is nearer to zero counts as zero
_SHIFT = 1.5 * 2.0**52  # added to a number, it leaves the next integer in the last bits
_OF_LOG = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)  # R(z) = z (first + z (...))
_DENORMALS_OFF = 0x8040  # of x86's control register: results flushed to zero, operands taken as zero


def text(loop: Loop, width: int, x86: bool) -> str:
    """The loop as a module of LLVM.

    Args:
        loop: what it computes.
        width: numbers in a vector.
        x86: whether the processor is one, and denormal numbers can be told to be zero.
    """
    return "\n".join(_Writer(loop, width, x86).module())


def _hex(value: float) -> str:
    return f"0x{struct.pack('>d', float(value)).hex().upper()}"


def _bits(value: float) -> int:
    """The bits of a double, as an integer."""
    return struct.unpack(">q", struct.pack(">d", value))[0]


class _Writer:
    """Lines of one module."""

    def __init__(self, loop: Loop, width: int, x86: bool) -> None:
        self.loop, self.graph, self.width, self.x86 = loop, loop.graph, width, x86
        self.lines: list[str] = []
        self.values: dict[int, str] = {}  # node -> its name or constant
        self.splats: dict[tuple[str, bool], str] = {}
        self.reciprocals: dict[tuple[int, bool], str] = {}
        self.declared: set[str] = set()
        self.count = 0
        divided = Counter(node[2] for k in loop.nodes if (node := self.graph.nodes[k])[0] == "div")
        # one division is a multiplication at each entry where others have its denominator, or no entry changes that
        often = {node for node, count in divided.items() if count > 1 or node not in loop.changing}
        self.inverted = {node for node in often if self.graph.known(node) is None}

    # types and constants

    def type(self, vector: bool, of: str = "double") -> str:
        return f"<{self.width} x {of}>" if vector else of

    def constant(self, value: float | bool, vector: bool) -> str:
        of, one = ("i1", str(int(value))) if isinstance(value, bool) else ("double", _hex(value))
        return f"<{', '.join([f'{of} {one}'] * self.width)}>" if vector else one

    def new(self, expression: str) -> str:
        """A name for a value."""
        self.count += 1
        self.lines.append(f"  %v{self.count} = {expression}")
        return f"%v{self.count}"

    def value_of(self, node: int, vector: bool) -> str:
        """The value of a node, spread over a vector where one is wanted."""
        known = self.graph.known(node)
        if known is not None:
            return self.constant(known, vector)
        name = self.values[node]
        return self.spread(name, self.graph.is_condition(node)) if vector and node not in self.loop.differing else name

    def spread(self, name: str, condition: bool) -> str:
        if (name, condition) not in self.splats:
            of = "i1" if condition else "double"
            first = self.new(f"insertelement {self.type(True, of)} poison, {of} {name}, i32 0")
            zeros = f"<{self.width} x i32> zeroinitializer"
            both = f"{self.type(True, of)} {first}, {self.type(True, of)} poison"
            self.splats[name, condition] = self.new(f"shufflevector {both}, {zeros}")
        return self.splats[name, condition]

    # memory

    def address(self, base: str, offset: int | str) -> str:
        return self.new(f"getelementptr double, ptr {base}, i64 {offset}")

    def load(self, base: str, offset: int | str, vector: bool) -> str:
        kind = self.type(vector)
        return self.new(f"load {kind}, ptr {self.address(base, offset)}, align 8")

    def store(self, value: str, base: str, offset: int) -> None:
        self.lines.append(f"  store {self.type(True)} {value}, ptr {self.address(base, offset)}, align 8")

    # the module

    def module(self) -> Iterator[str]:
        records = [f"ptr noalias %record{k}" for k in range(len(self.loop.records))]
        tables = [f"ptr noalias %{name}" for name in ("fixed", "carried", "sums", "stored")]
        arguments = ", ".join(["i64 %rows", "i64 %stride", *records, *tables])
        self.body()
        yield from sorted(f"declare {each}" for each in self.declared)
        yield f"define void @{NAME}({arguments}) nounwind {{"
        yield from self.lines
        yield "}"

    def body(self) -> None:
        """What is done before the rows, for each row, and after the last."""
        initial, sums = self.before_rows()
        head = len(self.lines)  # the phi nodes stand here; the second value of each is known at the end of a row
        results, totals = self.each_row(bool(initial), bool(sums))
        phis = ["  %row = phi i64 [ 0, %begin ], [ %next, %entry ]"]
        for name, before, after in (("carried", initial, results), ("sum", sums, totals)):
            # nothing begins in a register where the values stay in memory
            phis += [f"  %{name}{k} = phi {self.type(True)} [ {first}, %begin ], [ {last}, %entry ]"
                     for k, (first, last) in enumerate(zip(before, after, strict=False))]  # fmt: skip
        self.lines[head:head] = phis
        self.lines += ["  %next = add i64 %row, 1", "  %more = icmp slt i64 %next, %rows",
                       "  br i1 %more, label %entry, label %last", "last:"]  # fmt: skip
        for place, value in enumerate(results if initial else []):
            self.store(value, "%carried", place * self.width)
        for place, value in enumerate(totals if sums else []):
            self.store(value, "%sums", place * self.width)
        self.lines += ["  br label %end", "end:"]
        if self.x86:
            self.lines.append("  call void @llvm.x86.sse.ldmxcsr(ptr %control)")
        self.lines.append("  ret void")

    def before_rows(self) -> tuple[list[str], list[str]]:
        """Load and compute what no row changes.

        Returns:
            The values that are carried and the sums, as they begin; empty where they stay in memory, for there are too
            many of them for the registers.
        """
        loop = self.loop
        apart = loop.across is not Across.LANES  # the fixed values differ from entry to entry of a vector
        self.lines.append("begin:")
        if self.x86:
            self.without_denormals()
        for place, node in enumerate(loop.fixed):
            self.values[node] = self.load("%fixed", place * (self.width if apart else 1), apart)
        for node in loop.nodes:
            if node not in loop.changing and self.graph.operands(node):
                self.values[node] = self.operation(node)

        def loaded(base: str, count: int) -> list[str]:
            return [self.load(base, place * self.width, True) for place in range(count)] if count <= _KEPT else []

        initial, sums = loaded("%carried", len(loop.carried)), loaded("%sums", len(loop.sums))
        self.lines += self.begin_of_blocks()
        self.lines += ["  %some = icmp sgt i64 %rows, 0", "  br i1 %some, label %entry, label %end", "entry:"]
        return initial, sums

    def each_row(self, kept: bool, added: bool) -> tuple[list[str], list[str]]:
        """Load a row, compute and store what it makes.

        Args:
            kept: the values that are carried are in registers, and the sums too if `added`.
        Returns:
            The values that the next row gets, and the sums.
        """
        loop = self.loop
        if kept:
            for place, (node, _) in enumerate(loop.carried):
                self.values[node] = f"%carried{place}"
        self.load_records()
        if not kept:
            for place, (node, _) in enumerate(loop.carried):
                self.values[node] = self.load("%carried", place * self.width, True)
        for node in loop.nodes:
            if node in loop.changing and self.graph.operands(node):
                self.values[node] = self.operation(node)
        totals = [self.added(place, f"%sum{place}" if added else None) for place in range(len(loop.sums))]
        results = [self.value_of(result, True) for _, result in loop.carried]
        self.write()
        for place, value in enumerate(results if not kept else []):
            self.store(value, "%carried", place * self.width)
        return results, totals

    def load_records(self) -> None:
        """Load what this row has in the records, of what is used."""
        loop, used = self.loop, set(self.loop.nodes)
        along = loop.across is not Across.POINTS  # the records differ from entry to entry of a vector
        for k, record in enumerate(loop.records):
            stride = "1" if k in loop.common else "%stride"
            self.lines.append(f"  %size{k} = mul i64 {stride}, {len(record)}")
            self.lines.append(f"  %skip{k} = mul i64 %row, %size{k}")
            self.lines.append(f"  %at{k} = getelementptr double, ptr %record{k}, i64 %skip{k}")
        for k, record in enumerate(loop.records):
            for place, node in enumerate(record):
                if node in used:
                    common = k in loop.common
                    offset = place if common else self.new(f"mul i64 %stride, {place}")
                    self.values[node] = self.load(f"%at{k}", offset, along and not common)

    @property
    def blocks(self) -> list[tuple[int, int]]:
        """Begin and size of each block of what is stored."""
        sizes = self.loop.blocks or (len(self.loop.stored),)
        return [(sum(sizes[:k]), size) for k, size in enumerate(sizes) if size]

    def begin_of_blocks(self) -> Iterator[str]:
        for k, (begin, _) in enumerate(self.blocks):
            yield f"  %before{k} = mul i64 %rows, {begin * self.width}"
            yield f"  %block{k} = getelementptr double, ptr %stored, i64 %before{k}"

    def write(self) -> None:
        """What this entry stores."""
        for k, (begin, size) in enumerate(self.blocks):
            self.lines.append(f"  %skipped{k} = mul i64 %row, {size * self.width}")
            self.lines.append(f"  %out{k} = getelementptr double, ptr %block{k}, i64 %skipped{k}")
            for place, node in enumerate(self.loop.stored[begin : begin + size]):
                self.store(self.value_of(node, True), f"%out{k}", place * self.width)

    def added(self, place: int, before: str | None) -> str:
        """A sum with this entry's products."""
        kind = self.type(True)
        total = before or self.load("%sums", place * self.width, True)
        for a, b in self.loop.sums[place]:
            product = self.new(f"fmul {_FLAGS} {kind} {self.value_of(a, True)}, {self.value_of(b, True)}")
            total = self.new(f"fadd {_FLAGS} {kind} {total}, {product}")
        if before is None:
            self.store(total, "%sums", place * self.width)
        return total

    def without_denormals(self) -> None:
        self.declared |= {"void @llvm.x86.sse.stmxcsr(ptr)", "void @llvm.x86.sse.ldmxcsr(ptr)"}
        self.lines += [
            "  %control = alloca i32",
            "  %quick = alloca i32",
            "  call void @llvm.x86.sse.stmxcsr(ptr %control)",
            "  %usual = load i32, ptr %control",
            f"  %flushed = or i32 %usual, {_DENORMALS_OFF}",
            "  store i32 %flushed, ptr %quick",
            "  call void @llvm.x86.sse.ldmxcsr(ptr %quick)",
        ]

    # operations

    def operation(self, node: int) -> str:
        """The value of an operation whose operands are computed."""
        name, *operands = self.graph.nodes[node]
        vector = node in self.loop.differing
        kind, given = self.type(vector), [self.value_of(each, vector) for each in operands]
        if name == "div" and operands[1] in self.inverted:
            return self.new(f"fmul {_FLAGS} {kind} {given[0]}, {self.reciprocal(operands[1], given[1], vector)}")
        if name in _ARITHMETIC:
            return self.new(f"{_ARITHMETIC[name]} {_FLAGS} {kind} {given[0]}, {given[1]}")
        if name in _COMPARED:
            return self.new(f"fcmp {_COMPARED[name]} {kind} {given[0]}, {given[1]}")
        if name in _INTRINSIC:
            return self.intrinsic(_INTRINSIC[name], given, vector)
        if name in LIBRARY:
            return self.called(name, given, vector)
        return self.special(name, operands, given, vector)

    def special(self, name: str, operands: Sequence[int], given: list[str], vector: bool) -> str:
        kind, logic = self.type(vector), self.type(vector, "i1")
        match name:
            case "neg":
                return self.new(f"fneg nsz {kind} {given[0]}")
            case "and" | "or":
                return self.new(f"{name} {logic} {given[0]}, {given[1]}")
            case "not":
                return self.new(f"xor {logic} {given[0]}, {self.constant(True, vector)}")
            case "number":
                return self.new(f"uitofp {logic} {given[0]} to {kind}")
            case "choose":
                of = logic if self.graph.is_condition(operands[1]) else kind
                return self.select(*given, vector=vector, of=of)
            case "max" | "min":
                return self.extreme(name, operands, given, vector)
            case "clamp":
                low, value, high = given
                raised = self.select(self.new(f"fcmp ult {kind} {value}, {low}"), low, value, vector=vector)
                raised = self.select(self.new(f"fcmp uno {kind} {value}, {value}"), value, raised, vector=vector)
                return self.select(self.new(f"fcmp ogt {kind} {raised}, {high}"), high, raised, vector=vector)
            case "sign":
                zero, one, less = (self.constant(each, vector) for each in (0.0, 1.0, -1.0))
                below = self.select(self.new(f"fcmp olt {kind} {given[0]}, {zero}"), less, zero, vector=vector)
                return self.select(self.new(f"fcmp ogt {kind} {given[0]}, {zero}"), one, below, vector=vector)
            case "is_finite":
                size = self.intrinsic("fabs", given, vector)
                return self.new(f"fcmp olt {kind} {size}, {self.constant(math.inf, vector)}")
            case "exp":
                return self.exponential(given[0], vector)
            case "log":
                return self.logarithm(given[0], None, vector)
            case "log1p":
                return self.logarithm(self.sum_with_one(given[0], vector), given[0], vector)
        raise NotImplementedError(f"machine code has no {name!r}")

    def select(self, condition: str, met: str, otherwise: str, vector: bool, of: str | None = None) -> str:
        kind = of or self.type(vector)
        return self.new(f"select {self.type(vector, 'i1')} {condition}, {kind} {met}, {kind} {otherwise}")

    def extreme(self, name: str, operands: Sequence[int], given: list[str], vector: bool) -> str:
        """The larger or smaller of two numbers; what is no number stays none, as it must where a simulation fails."""
        kind = self.type(vector)
        (a, b), wins = given, "ugt" if name == "max" else "ult"  # unordered: a wins where it is none
        if self.graph.known(operands[0]) is not None:
            a, b = b, a
        found = self.select(self.new(f"fcmp {wins} {kind} {a}, {b}"), a, b, vector=vector)
        if any(self.graph.known(each) is not None for each in operands):
            return found
        return self.select(self.new(f"fcmp uno {kind} {b}, {b}"), b, found, vector=vector)

    def reciprocal(self, node: int, name: str, vector: bool) -> str:
        """1 / a, once for all that is divided by a."""
        if (node, vector) not in self.reciprocals:
            one = self.constant(1.0, vector)
            self.reciprocals[node, vector] = self.new(f"fdiv {_FLAGS} {self.type(vector)} {one}, {name}")
        return self.reciprocals[node, vector]

    def intrinsic(self, name: str, given: Sequence[str], vector: bool) -> str:
        kind = self.type(vector)
        full = f"@llvm.{name}.{f'v{self.width}f64' if vector else 'f64'}"
        self.declared.add(f"{kind} {full}({', '.join([kind] * len(given))})")
        return self.new(f"call {kind} {full}({', '.join(f'{kind} {each}' for each in given)})")

    def called(self, name: str, given: Sequence[str], vector: bool) -> str:
        """A function of C's library, number by number."""
        self.declared.add(f"double @{name}({', '.join(['double'] * len(given))}) memory(none)")
        if not vector:
            return self.new(f"call double @{name}({', '.join(f'double {each}' for each in given)})")
        kind, out = self.type(True), "poison"
        for k in range(self.width):
            each = [self.new(f"extractelement {kind} {value}, i32 {k}") for value in given]
            one = self.new(f"call double @{name}({', '.join(f'double {value}' for value in each)})")
            out = self.new(f"insertelement {kind} {out}, double {one}, i32 {k}")
        return out

    def exponential(self, x: str, vector: bool) -> str:
        """e^x = 2^n e^r with |r| <= ln(2)/2, e^r by its series to the 12th power: to some units of the last digit.

        Source: Muller 2016, Elementary functions, ch. 11 (ln 2 in two parts). Differs from source: no.
        """
        kind, whole = self.type(vector), self.type(vector, "i64")

        def number(value: float) -> str:
            return self.constant(value, vector)

        def integer(value: int) -> str:
            return f"<{', '.join([f'i64 {value}'] * self.width)}>" if vector else str(value)

        low, high = number(-708.0), number(709.0)
        within = self.select(self.new(f"fcmp olt {kind} {x}, {low}"), low, x, vector=vector)
        within = self.select(self.new(f"fcmp ogt {kind} {within}, {high}"), high, within, vector=vector)
        scaled = self.new(f"fmul {kind} {within}, {number(1.4426950408889634)}")
        shifted = self.new(f"fadd {kind} {scaled}, {number(_SHIFT)}")
        n = self.new(f"fsub {kind} {shifted}, {number(_SHIFT)}")
        rest = within
        for part in (0.693147180369123816490, 1.90821492927058770002e-10):
            taken = self.new(f"fmul {_FLAGS} {kind} {n}, {number(part)}")
            rest = self.new(f"fsub {_FLAGS} {kind} {rest}, {taken}")
        total = self.polynomial([1.0 / math.factorial(k) for k in range(13)], rest, vector)
        exponent = self.new(f"shl {whole} {self.new(f'bitcast {kind} {shifted} to {whole}')}, {integer(52)}")
        bits = self.new(f"add {whole} {self.new(f'bitcast {kind} {total} to {whole}')}, {exponent}")
        found = self.new(f"bitcast {whole} {bits} to {kind}")
        found = self.select(self.new(f"fcmp olt {kind} {x}, {low}"), number(0.0), found, vector=vector)
        found = self.select(self.new(f"fcmp ogt {kind} {x}, {high}"), number(math.inf), found, vector=vector)
        return self.select(self.new(f"fcmp uno {kind} {x}, {x}"), x, found, vector=vector)

    def polynomial(self, coefficients: Sequence[float], x: str, vector: bool) -> str:
        """c0 + c1 x + c2 x^2 ..., in pairs, pairs of pairs ..., which do not wait for each other.

        Source: Estrin 1960. Differs from source: no.
        """
        kind, terms = self.type(vector), [self.constant(each, vector) for each in coefficients]
        while len(terms) > 1:
            pairs = []
            for k in range(0, len(terms) - 1, 2):
                product = self.new(f"fmul {_FLAGS} {kind} {terms[k + 1]}, {x}")
                pairs.append(self.new(f"fadd {_FLAGS} {kind} {product}, {terms[k]}"))
            terms = [*pairs, *terms[2 * len(pairs) :]]
            x = self.new(f"fmul {kind} {x}, {x}") if len(terms) > 1 else x
        return terms[0]

    def sum_with_one(self, x: str, vector: bool) -> str:
        return self.new(f"fadd {self.type(vector)} {x}, {self.constant(1.0, vector)}")

    def logarithm(self, u: str, x: str | None, vector: bool) -> str:
        """log u = k ln 2 + log(1 + f),  u = 2^k (1 + f),  sqrt(1/2) <= 1 + f < sqrt(2),  s = f / (2 + f)

            log(1 + f) = f - (f^2/2 - s (f^2/2 + R(s^2))),      log(1 + x) = log u + (x - (u - 1)) / u,  u = 1 + x

        to a unit of the last digit. What is below the least normal number counts as zero.

        Source: log and log1p of the C library fdlibm 5.3 (Sun Microsystems). Differs from source: no case by case.

        Args:
            u: the number.
            x: it less 1, where the logarithm is that of 1 + x; else None.
            vector: whether they are vectors.
        """
        kind, whole = self.type(vector), self.type(vector, "i64")

        def number(value: float) -> str:
            return self.constant(value, vector)

        def integer(value: int) -> str:
            return f"<{', '.join([f'i64 {value}'] * self.width)}>" if vector else str(value)

        def exactly(operation: str, a: str, b: str) -> str:
            return self.new(f"{operation} {kind} {a}, {b}")

        bits = self.new(f"bitcast {kind} {u} to {whole}")
        above = self.new(f"sub {whole} {bits}, {integer(_bits(math.sqrt(0.5)))}")
        shifted = self.new(f"add {whole} {self.new(f'ashr {whole} {above}, {integer(52)}')}, {integer(_bits(_SHIFT))}")
        k = exactly("fsub", self.new(f"bitcast {whole} {shifted} to {kind}"), number(_SHIFT))
        rest = self.new(f"and {whole} {above}, {integer((1 << 52) - 1)}")
        mantissa = self.new(f"add {whole} {rest}, {integer(_bits(math.sqrt(0.5)))}")
        f = exactly("fsub", self.new(f"bitcast {whole} {mantissa} to {kind}"), number(1.0))
        lost = number(0.0)
        if x is not None:
            still = self.new(f"fcmp oeq {kind} {k}, {number(0.0)}")
            f = self.select(still, x, f, vector=vector)
            large = self.new(f"fcmp oge {kind} {k}, {number(2.0)}")
            of_small = exactly("fsub", x, exactly("fsub", u, number(1.0)))
            of_large = exactly("fsub", number(1.0), exactly("fsub", u, x))
            missing = self.select(large, of_large, of_small, vector=vector)
            inverse = self.new(f"fdiv {_FLAGS} {kind} {number(1.0)}, {u}")  # derivatives have it too
            lost = self.select(still, number(0.0), exactly("fmul", missing, inverse), vector=vector)
        s = exactly("fdiv", f, exactly("fadd", f, number(2.0)))
        z = exactly("fmul", s, s)
        total = self.polynomial(_OF_LOG, z, vector)
        total = exactly("fmul", total, z)
        half = exactly("fmul", number(0.5), exactly("fmul", f, f))
        low = exactly("fadd", lost, exactly("fmul", k, number(1.90821492927058770002e-10)))
        inner = exactly("fadd", low, exactly("fmul", s, exactly("fadd", half, total)))
        found = exactly("fsub", f, exactly("fsub", half, inner))
        found = exactly("fadd", found, exactly("fmul", k, number(0.693147180369123816490)))
        found = self.select(self.new(f"fcmp oeq {kind} {u}, {number(math.inf)}"), u, found, vector=vector)
        found = self.select(self.new(f"fcmp olt {kind} {u}, {number(_LEAST)}"), number(-math.inf), found, vector=vector)
        return self.select(self.new(f"fcmp ult {kind} {u}, {number(0.0)}"), number(math.nan), found, vector=vector)
