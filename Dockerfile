# Built and run with Buildah, on a Debian 12 made by debootstrap. Untried: Docker, Podman, Apptainer, and
# Debian's own image (docs/deploy.md). The image contains ducc0 and surfalize: as a whole it may be
# distributed under the terms of the GPL only.
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends git make python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/gst
COPY CITATION.cff LICENSE Makefile README.md Snakefile pyproject.toml requirements.lock ./
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
