"""What every route needs: problems, replies, validation, the document of the API."""
