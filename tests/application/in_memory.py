"""A study whose results are in memory, for tests of what is made from them."""

from gst.page.results import Results


class InMemory(Results):
    """A study whose files are their contents: tables by name, datasets by file name."""

    @property
    def tables(self):
        return self.files

    def table(self, name):
        return self.files[name]

    def data(self, name, *only):
        return self.files.get(f"{name}.h5")

    def has(self, name):
        return f"{name}.h5" in self.files
