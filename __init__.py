"""Mirror Scan: a closed, coloured avatar from one depth camera, mirrors and one snapshot."""


def register() -> None:
    """Register the Blender add-on."""
    from . import mirror_scan_addon

    mirror_scan_addon.register()


def unregister() -> None:
    """Unregister the Blender add-on."""
    from . import mirror_scan_addon

    mirror_scan_addon.unregister()
