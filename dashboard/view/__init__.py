"""What both pages show at one moment: pure functions of the latest messages and the time.

`build.build_view` is the 3D view's, of the views of roads, roadside units and vehicles that the
operator's page makes its rows of, too.
"""
