"""Every standard name comes from a header that the project's own files ask for, not from one that happens to bring it.

Which header brings which other differs from one standard library, and from one release of it, to the next.
"""

import os
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = [
    p for d in ("cpp", "tests/cpp", "tests/fuzz") for p in sorted((ROOT / d).rglob("*")) if p.suffix in (".h", ".cpp")
]
ROOTS = [ROOT / d for d in ("cpp", "tests/cpp", "tests/fuzz")]
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^">]+)[">]', re.M)

FUNCTIONS = {  # by header, those that are called by name in std
    "algorithm": "min max clamp sort stable_sort fill fill_n copy copy_n copy_if transform find find_if any_of all_of"
    " none_of count count_if nth_element lower_bound upper_bound minmax max_element min_element minmax_element"
    " remove_if unique reverse rotate partition for_each generate binary_search is_sorted push_heap pop_heap make_heap",
    "cmath": "sqrt abs pow exp log sin cos tan atan2 atan acos asin floor ceil round lround hypot isfinite isnan isinf"
    " fmod cbrt exp2 log2 log10 ldexp frexp fma copysign signbit nearbyint rint lrint tanh erf expm1 log1p trunc",
    "cstdio": "printf fprintf snprintf fopen fclose fread fwrite fflush sscanf",
    "cstdlib": "getenv malloc free abort exit strtod strtol strtof strtoul",
    "cstring": "memcpy memset memcmp memmove strlen strcmp strncmp strstr",
    "numeric": "accumulate iota inner_product partial_sum reduce gcd lcm",
}
OTHERS = {
    "array": r"std::array\b",
    "atomic": r"std::(atomic|memory_order\w*)\b",
    "chrono": r"std::chrono\b",
    "cstddef": r"std::(byte|nullptr_t|ptrdiff_t|max_align_t)\b",
    "cstdint": r"\bu?int(8|16|32|64)_t\b",
    "exception": r"std::(exception_ptr|current_exception|rethrow_exception|terminate)\b",
    "filesystem": r"std::filesystem\b",
    "fstream": r"std::[io]?fstream\b",
    "functional": r"std::(function|greater|less|hash|ref|cref)\b",
    "iostream": r"std::(cout|cerr|cin)\b",
    "limits": r"std::numeric_limits\b",
    "map": r"std::map\b",
    "memory": r"std::(unique_ptr|shared_ptr|weak_ptr|make_unique|make_shared)\b",
    "mutex": r"std::(mutex|lock_guard|unique_lock|scoped_lock|once_flag|call_once)\b",
    "optional": r"std::(optional|nullopt)\b",
    "set": r"std::set\b",
    "sstream": r"std::[io]?stringstream\b",
    "stdexcept": r"std::(runtime_error|invalid_argument|logic_error|out_of_range)\b",
    "string": r"std::(string|to_string|stoi|stod|stof)\b",
    "string_view": r"std::string_view\b",
    "thread": r"std::(thread|this_thread)\b",
    "tuple": r"std::(tuple|make_tuple|tie)\b",
    "unordered_map": r"std::unordered_map\b",
    "variant": r"std::(variant|visit|monostate)\b",
    "vector": r"std::vector\b",
}
NAMES = {header: rf"std::({'|'.join(names.split())})\(" for header, names in FUNCTIONS.items()} | OTHERS


def standard_headers(path: Path, seen: set[Path]) -> set[str]:
    """Those that a file asks for, or that the project's files it includes ask for."""
    if path in seen:
        return set()
    seen.add(path)
    found = set()
    for name in INCLUDE.findall(path.read_text()):
        own = [p for base in (path.parent, *ROOTS) if (p := Path(os.path.normpath(base / name))).is_file()]
        found |= standard_headers(own[0], seen) if own else {name}
    return found


def code(path: Path) -> str:
    """The text of a file without comments, strings and includes."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", INCLUDE.sub("", path.read_text()), flags=re.S)
    return re.sub(r'"(\\.|[^"\\\n])*"', '""', text)


def missing(path: Path) -> list[str]:
    have, text = standard_headers(path, set()), code(path)
    found = [(header, re.search(pattern, text)) for header, pattern in NAMES.items() if header not in have]
    return [f"{path.relative_to(ROOT)}: {m[0].rstrip('(')} needs <{header}>" for header, m in found if m]


def test_every_standard_name_comes_from_a_header_that_is_asked_for():
    assert len(FILES) > 200
    assert not (lacks := [line for path in FILES for line in missing(path)]), "\n".join(lacks)


def test_a_missing_header_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr("test_includes.ROOT", tmp_path)
    file = tmp_path / "a.cpp"
    file.write_text("#include <vector>\n// std::string\nstd::vector<std::uint64_t> a; auto b = std::max(1, 2);\n")
    assert missing(file) == ["a.cpp: std::max needs <algorithm>", "a.cpp: uint64_t needs <cstdint>"]
