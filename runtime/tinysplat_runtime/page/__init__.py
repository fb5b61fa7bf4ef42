"""A scene as one web page that loads nothing from anywhere: `build.scene_page`; WebGL2 draws it as `render` does."""
