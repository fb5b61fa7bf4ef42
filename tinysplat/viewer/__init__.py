"""A scene as one web page that opens without a network: `page.build_page`.

`libraries.js.gz` holds three.js and Spark (MIT, LICENSES.txt), bundled by `export/viewer`; `viewer.html` and
`viewer.js` are the page around them.
"""
