"""A scene as one web page that opens without a network: `page.build_page`.

`viewer.html` and `viewer.js` are the page. `libraries.js.gz`, which `make viewer` builds from `export/viewer`, holds
three.js and Spark (MIT); it is in wheels, never in the source tree.
"""
