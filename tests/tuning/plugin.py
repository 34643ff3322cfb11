"""Packages that add something to vsajax, laid out as an installation leaves them."""

from __future__ import annotations

import shutil
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "plugin"
STUDY, SLOPE = EXAMPLE / "study.toml", EXAMPLE / "slope.toml"
_PROJECT = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def install(
    site: Path,
    *,
    name: str,
    version: str = "1.0",
    points: Mapping[str, Mapping[str, str]],
    module: str = "",
) -> None:
    """Put a package of one module, called as its distribution, and its metadata into a folder of the path."""
    site.mkdir(exist_ok=True)
    (site / f"{name.replace('-', '_')}.py").write_text(module, encoding="utf-8")
    _write_metadata(site, name, version, points)


def install_example(site: Path, version: str = _PROJECT["version"]) -> None:
    """Put the example package and its metadata into a folder of the path."""
    site.mkdir(exist_ok=True)
    shutil.copytree(EXAMPLE / "src" / "air_joint", site / "air_joint", dirs_exist_ok=True)
    _write_metadata(site, _PROJECT["name"], version, _PROJECT["entry-points"])


def wheel_of_example(folder: Path) -> Path:
    """Return a wheel of the example package, as its build back end would make it."""
    site = folder / "laid-out"
    install_example(site)
    (info,) = site.glob("*.dist-info")
    (info / "WHEEL").write_text("Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
    record = info / "RECORD"
    record.unlink()
    files = [path for path in sorted(site.rglob("*")) if path.is_file() and "__pycache__" not in path.parts]
    record.write_text("".join(f"{path.relative_to(site)},,\n" for path in [*files, record]))
    wheel = folder / f"{info.name.removesuffix('.dist-info')}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for path in [*files, record]:
            archive.write(path, path.relative_to(site))
    return wheel


def named(study: Path, target: Path) -> Path:
    """Write a study of the example with its parts named by their module, as one does where it is not installed."""
    tags = {}
    for points in _PROJECT["entry-points"].values():
        tags |= points
    text = study.read_text(encoding="utf-8")
    for tag, ref in tags.items():
        text = text.replace(f'type = "{tag}"', f'type = "{ref}"')
    target.write_text(text, encoding="utf-8")
    return target


def _write_metadata(site: Path, name: str, version: str, points: Mapping[str, Mapping[str, str]]) -> None:
    stem = name.replace("-", "_")
    for old in site.glob(f"{stem}-*.dist-info"):
        shutil.rmtree(old)
    info = site / f"{stem}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [f"[{group}]\n" + "".join(f"{t} = {r}\n" for t, r in tags.items()) for group, tags in points.items()]
    (info / "entry_points.txt").write_text("\n".join(lines))
    own = [path for one in site.glob(f"{stem}*") for path in (one, *one.rglob("*.py"))]
    (info / "RECORD").write_text("".join(f"{path.relative_to(site)},,\n" for path in own if path.is_file()))
