"""Topics of `dynid help TOPIC`, one Markdown file each."""
