# dynid in a container, with its C library and all extras of users:
#   docker build -t dynid . && docker run --rm -v "$PWD:/work" dynid run scene.yaml
FROM python:3.13-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --wheel-dir /wheels '.[figures,formats,laboratory,solvers,xarray]'

FROM python:3.13-slim
# libgomp1: threads of PARDISO
RUN apt-get update && apt-get install -y --no-install-recommends libgomp1 && rm -rf /var/lib/apt/lists/*
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    pip install --no-cache-dir --no-index --find-links /wheels 'dynid[figures,formats,laboratory,solvers,xarray]'
RUN useradd --create-home dynid
USER dynid
WORKDIR /work
ENTRYPOINT ["dynid"]
CMD ["--help"]
