"""What a person looks at after a study: the page, the answer, the viewer and the figures."""
