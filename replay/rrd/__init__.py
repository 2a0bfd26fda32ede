"""The only package that imports rerun: names, writer, reader and blueprints of a recording."""
