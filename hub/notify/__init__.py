"""Tells other programs and phones of movements and falls: webhooks, ntfy, Gotify, Slack, Discord."""
