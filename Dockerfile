# Built and run with Buildah, on a Debian 12 made by debootstrap. Untried: Docker, Podman, Apptainer, and
# Debian's own image, whose digest is that of docker-library/repo-info. docs/how-to/install.md lists licences:
# the study imports ducc0 (GPL, version 2 or later) and surfalize (version 3), so whoever passes the image on must
# heed the GPL 3 for the whole of it. codespell (GPL 2) is in it as a program of its own.
FROM debian:bookworm-20260918-slim@sha256:3783cc01769c7b2b1b83a5c5ad96c815348e28ed7da68e2e3687004faa906251
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
