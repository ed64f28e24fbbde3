"""What `dynid help TOPIC` prints, a Markdown file a topic."""
