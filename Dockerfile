FROM python:3.11-slim AS build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /src

# The environment has no pip of its own: the base's fills it, and the final image runs without one.
RUN python -m venv --without-pip /opt/wheelplan
COPY requirements.lock .
RUN pip --python /opt/wheelplan/bin/python install --only-binary :all: --require-hashes -r requirements.lock

# CasADi brings some twenty solvers, each library up to three times, with headers; only its expressions are in use.
# The last line fails where something is missing that they need.
RUN cd /opt/wheelplan/lib/python3.11/site-packages \
 && find casadi -mindepth 1 -maxdepth 1 ! -name '*.py' ! -name tools ! -name __pycache__ \
      ! -name _casadi.so ! -name 'libcasadi.so.*' -exec rm -r {} + \
 && find numpy scipy numba matplotlib -type d -name tests -prune -exec rm -r {} + \
 && /opt/wheelplan/bin/python -c "import casadi; casadi.hessian(casadi.SX.sym('x'), casadi.SX.sym('y'))"

# Only the build needs setuptools; its pin and hashes are in the development lock.
COPY requirements-dev.lock .
RUN awk '/^[^ ]/ { wanted = /^setuptools==/ } wanted' requirements-dev.lock > build.lock \
 && pip install --require-hashes -r build.lock
COPY pyproject.toml README.md ./
COPY drives drives
COPY planner planner
COPY api api
RUN pip wheel --no-deps --no-build-isolation --wheel-dir /dist . \
 && pip --python /opt/wheelplan/bin/python install --no-deps --no-index /dist/*.whl


FROM python:3.11-slim
RUN useradd --uid 10001 --no-create-home --home-dir /nonexistent --shell /usr/sbin/nologin wheelplan \
 && install -d -o wheelplan -g wheelplan /data /var/cache/wheelplan /var/cache/wheelplan/tmp
COPY --from=build /opt/wheelplan /opt/wheelplan

ENV PATH=/opt/wheelplan/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    WHEELPLAN_HOST=0.0.0.0 \
    WHEELPLAN_PORT=8000 \
    WHEELPLAN_DATA_DIR=/data \
    NUMBA_CACHE_DIR=/var/cache/wheelplan/numba \
    MPLCONFIGDIR=/var/cache/wheelplan/matplotlib \
    TMPDIR=/var/cache/wheelplan/tmp
USER wheelplan

# Compiled once, here, instead of by every new container. Another kind of processor compiles again at its first start.
RUN python -W error -c "from planner.kernels import make_ready; make_ready()"

# Volumes, so that a container with a read-only root can still write to both; a new one begins with the image's content.
VOLUME ["/data", "/var/cache/wheelplan"]
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=60s CMD ["python", "-c", "import os, urllib.request as r; r.build_opener(r.ProxyHandler({})).open(f\"http://127.0.0.1:{os.environ['WHEELPLAN_PORT']}/livez\", timeout=2)"]
CMD ["wheelplan", "serve"]
