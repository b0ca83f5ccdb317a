"""What every route needs: finding axes, tasks, waiting, problems, replies, the document of the API."""
