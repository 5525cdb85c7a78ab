"""The questionnaires that ship with haptigraph, and how a questionnaire is scored."""
