"""A scene as one web page that loads nothing from anywhere: `build.build_page`; WebGL2 draws it as `render` does."""
