# An image with the `dtd` command, as deploy/k8s/generate-job.yaml wants it. It contains the archive of scripts/package.sh:
#
#   docker build -t dtd .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" dtd demo --out demo
#
# Without --user, dtd runs as the user 1001, which has a home and owns nothing else; GitHub's runners have the same number.
FROM rust:1-bookworm AS build
WORKDIR /dtd
COPY . .
RUN bash scripts/package.sh && mkdir /opt/dtd && tar -xzf target/packages/dtd-*64.tar.gz -C /opt/dtd --strip-components=1

FROM debian:bookworm-slim
# FFmpeg's libraries, the certificates of object stores, and Python for `dtd mock-xplane --plugin`.
RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates libavdevice59 python3 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /opt/dtd /opt/dtd
ENV PATH=/opt/dtd/bin:$PATH
RUN useradd --uid 1001 --create-home dtd && install -d -o dtd -g dtd /work
WORKDIR /work
USER 1001
ENTRYPOINT ["dtd"]
CMD ["--help"]
