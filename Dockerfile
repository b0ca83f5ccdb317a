# One image for both services of docker-compose.yml: the command `canaxis` and all that it needs.
FROM python:3.12-slim
WORKDIR /opt/canaxis
COPY requirements.lock ./
RUN pip install --no-cache-dir --require-hashes -r requirements.lock
COPY pyproject.toml README.md LICENSE ./
COPY app ./app
COPY drivers ./drivers
COPY canaxis ./canaxis
COPY canaxis_command ./canaxis_command
RUN pip install --no-cache-dir --no-deps --no-build-isolation . \
    && useradd --system --no-create-home canaxis && install -d -o canaxis /var/lib/canaxis
ENV CANAXIS_STORE__FILE=/var/lib/canaxis/canaxis.db
VOLUME /var/lib/canaxis
USER canaxis
ENTRYPOINT ["canaxis"]
CMD ["serve"]
