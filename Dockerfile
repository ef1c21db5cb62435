# An image with the `dtd` command, as deploy/k8s/generate-job.yaml wants it:
#
#   docker build -t dtd .
#   docker run --rm -v "$PWD:/work" dtd demo --out demo
FROM rust:1-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends python3 python3-venv && rm -rf /var/lib/apt/lists/*
WORKDIR /dtd
COPY . .
RUN bash scripts/install.sh /opt/dtd

FROM debian:bookworm-slim
# FFmpeg's libraries, the certificates of object stores, and Python for `dtd mock-xplane --plugin`.
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        ca-certificates libavcodec59 libavdevice59 libavfilter8 libavformat59 libavutil57 libswresample4 libswscale6 python3 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /opt/dtd /opt/dtd
ENV PATH=/opt/dtd/bin:$PATH
WORKDIR /work
ENTRYPOINT ["dtd"]
CMD ["--help"]
