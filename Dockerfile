# An image with the `dtd` command, as deploy/k8s/generate-job.yaml wants it. It contains the archive of scripts/package.sh:
#
#   docker build -t dtd .
#   docker run --rm -v "$PWD:/work" dtd demo --out demo
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
WORKDIR /work
ENTRYPOINT ["dtd"]
CMD ["--help"]
