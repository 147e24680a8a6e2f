# Built and run with Buildah, on a Debian 12 made by debootstrap. Untried: Docker, Podman, Apptainer, and
# Debian's own image (docs/how-to/install.md). The study imports ducc0 (GPL, version 2 or later) and surfalize
# (version 3): whoever passes the image on must heed the GPL 3 for the whole of it. codespell (GPL 2), of
# the locked packages for development, is in it as a program of its own.
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends git make python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/gst
COPY CITATION.cff LICENSE Makefile README.md Snakefile pyproject.toml requirements-build.lock requirements.lock ./
COPY config config
COPY profiles profiles
COPY src src
COPY workflow workflow
# the locked versions, checked by their hashes, and gstlib
RUN make environment
# a home for caches and a name, for whoever runs it: Snakemake fails without
ENV PATH=/opt/gst/.venv/bin:$PATH HOME=/tmp USER=gst
WORKDIR /study
# not snakemake: it would run code from a config that says __use_yte__
ENTRYPOINT ["gst"]
