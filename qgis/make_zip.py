"""`python qgis/make_zip.py [DIRECTORY]` writes deglint_qgis.zip for Plugins, Install from ZIP in QGIS."""

import sys
import zipfile
from pathlib import Path

PLUGIN = Path(__file__).parent / "deglint_qgis"


def make_zip(directory: Path) -> Path:
    """Write the plugin as an archive; its name."""
    directory.mkdir(parents=True, exist_ok=True)
    out = directory / f"{PLUGIN.name}.zip"
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(PLUGIN.iterdir()):
            if path.suffix in (".py", ".txt"):
                archive.write(path, f"{PLUGIN.name}/{path.name}")
        archive.write(PLUGIN.parents[1] / "LICENSE", f"{PLUGIN.name}/LICENSE")
    return out


if __name__ == "__main__":
    sys.stdout.write(f"{make_zip(Path(sys.argv[1] if len(sys.argv) > 1 else '.'))}\n")
