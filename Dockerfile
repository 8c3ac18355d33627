# The demo in a container: docker build -t tendril . && docker run --rm -v "$PWD/out:/out" tendril
FROM debian:12
COPY . /tendril
# Installs what the build needs, builds the programs, and shows that they work.
RUN /tendril/tools/demo --no-plots --out /tmp/first && rm -rf /tmp/first
ENTRYPOINT ["/tendril/tools/demo", "--out", "/out"]
