"""What a reader sees: Markdown, figures, result.json, ArviZ and pandas; one file a subject.  Read
`analysis` first.
"""
