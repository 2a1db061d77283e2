"""What registering adds, unregistering takes away; and neither costs a start of Blender anything."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[2]


def run_fresh(code: str, **environment: str) -> str:
    """Standard output of ``code`` in a new Python that has the checkout as ``mirror_scan``."""
    import os

    preamble = f"import sys, runpy; runpy.run_path({str(ROOT / 'tests' / 'conftest.py')!r})\n"
    done = subprocess.run(
        [sys.executable, "-c", preamble + code],
        capture_output=True, text=True, timeout=120, env={**os.environ, **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_registering_imports_nothing_heavy():
    """What it takes is measured by ``python -m benchmarks --only import``."""
    code = """
import mirror_scan, bpy
before = set(sys.modules)
mirror_scan.register()
new = {name.split(".")[0] for name in set(sys.modules) - before}
print("HEAVY", sorted(new & {"numba", "llvmlite", "scipy", "tqdm", "numpy", "subprocess", "tempfile"}))
"""
    assert run_fresh(code).splitlines()[-1] == "HEAVY []"


def test_importing_needs_no_bpy():
    assert (
        run_fresh(
            """
sys.modules["bpy"] = None  # a Python without it
import mirror_scan.mirror_scan_addon.command as command
print(sorted(command.BlenderWriters()), ".glb" in command.BlenderWriters(), ".ply" in command.BlenderWriters())
"""
        )
        == "['.blend', '.fbx', '.glb', '.usd', '.usdc'] True False\n"
    )


def test_cycles_leave_nothing(bpy, addon):
    def look():
        return (
            sorted(name for name in dir(bpy.types) if name.startswith("MIRRORSCAN_")),
            sorted(dir(bpy.ops.mirror_scan)),
            "mirror_scan" in bpy.types.Scene.bl_rna.properties,
            "mirror_scan" in bpy.types.WindowManager.bl_rna.properties,
            {name: len(getattr(bpy.app.handlers, name)) for name in dir(bpy.app.handlers)
             if isinstance(getattr(bpy.app.handlers, name), list)},
            len(bpy.types.Operator.__subclasses__()),
        )  # fmt: skip

    registered = look()
    assert "build_avatar" in registered[1]
    addon.unregister()
    bare = look()
    assert bare[0] == [] and bare[1] == [] and not bare[2] and not bare[3]
    for _ in range(50):
        addon.register()
        assert look() == registered
        addon.unregister()
        assert look() == bare
    addon.register()


def test_a_failing_registration_takes_back_what_it_added(bpy, addon, monkeypatch):
    from mirror_scan.mirror_scan_addon.interface import panels

    def fail():
        raise RuntimeError("no room")

    addon.unregister()
    with monkeypatch.context() as patch:
        patch.setattr(panels, "register", fail)
        with pytest.raises(RuntimeError, match="no room"):
            addon.register()
    assert dir(bpy.ops.mirror_scan) == [] and not hasattr(bpy.types.Scene, "mirror_scan")
    addon.register()


def test_texts_follow_the_house_style(addon, bpy):
    """Every operator and property has a name and a description without a full stop at its end."""
    from mirror_scan.mirror_scan_addon.scene import properties

    described = [getattr(bpy.types, name).bl_rna for name in dir(bpy.types) if name.startswith("MIRRORSCAN_")]
    described += [getattr(bpy.ops.mirror_scan, name).get_rna_type() for name in dir(bpy.ops.mirror_scan)]
    described += [kind.bl_rna for name, kind in vars(properties).items() if name.startswith("MIRRORSCAN_PG_")]
    assert len(described) > 30 and sum(len(rna.properties) for rna in described) > 100
    for rna in described:
        if "_OT_" in rna.identifier:
            assert rna.description and not rna.description.endswith("."), rna.identifier
        if "_PT_" in rna.identifier:
            continue
        for prop in rna.properties:
            if prop.is_runtime and rna.identifier != "MIRROR_SCAN_OT_add_quality_preset":  # those are Blender's
                assert prop.name and not prop.description.endswith("."), (rna.identifier, prop.identifier)
                shown = not prop.is_hidden and "_PG_progress" not in rna.identifier
                assert prop.description or not shown, (rna.identifier, prop.identifier)


def test_a_script_may_end_without_unregistering():
    """bpy 4.5 hangs or crashes at exit when something is left registered; ``run_fresh`` would see either."""
    assert "end" in run_fresh("import mirror_scan; mirror_scan.register(); print('end')").splitlines()
