# docker build -t contact-locking .
# docker run --rm -v "$PWD:/work" contact-locking mpirun -n 2 contact-locking run study.yml
FROM debian:trixie-slim

COPY environment/debian-packages.txt /tmp/
RUN apt-get update \
    && sed 's/#.*//' /tmp/debian-packages.txt \
        | DEBIAN_FRONTEND=noninteractive xargs apt-get install -y --no-install-recommends \
    && rm -rf /var/lib/apt/lists/* /tmp/debian-packages.txt

# One thread per MPI rank, more ranks than cores allowed, ranks on one machine that yield the core while they wait. HOME is where compiled forms are kept: open to any user, as
# docker run --user may be given one that the image does not know.
ENV LC_ALL=C.UTF-8 \
    HOME=/home/solver \
    OMP_NUM_THREADS=1 \
    OMPI_ALLOW_RUN_AS_ROOT=1 \
    OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 \
    OMPI_MCA_btl=self,sm \
    OMPI_MCA_mpi_yield_when_idle=1 \
    PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe
RUN useradd --create-home --home-dir /home/solver solver && chmod 1777 /home/solver

# Debian's own packages stay as they are (--no-deps), so nothing breaks in the system's Python.
COPY . /tmp/source
RUN python3 -m pip install --no-cache-dir --no-deps --no-build-isolation --break-system-packages --root-user-action=ignore \
        /tmp/source \
    && rm -rf /tmp/source

USER solver
WORKDIR /work
CMD ["contact-locking", "--help"]
